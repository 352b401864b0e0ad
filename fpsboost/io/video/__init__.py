"""Reading and writing of video files and video streams with FFmpeg, through PyAV."""
