"""Video files and streams of pictures: FFmpeg decodes and encodes, through PyAV."""
