"""Video files, kept whole: their pictures, and everything else that they hold, read and written by FFmpeg.

Nothing here knows of interpolation, of images as arrays, or of any other part of the package.

- `open` ``(path)``: a `Clip`, whose pictures are ``av.VideoFrame`` at exact times;
- `create` ``(path, like=clip)``: a `Writer` of pictures, which carries over all other streams, tags and properties;
- `inspect` ``(path)``: the `Facts` on a file.
"""

import lazy_loader

# on first use, so that `fpsboost --help` does not wait for FFmpeg
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
