"""Video files, kept whole: their pictures, and everything else that they hold, read and written by FFmpeg.

Nothing here knows of interpolation, of images as arrays, or of any other part of the package.
"""
