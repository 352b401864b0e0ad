"""Analysis of frames before motion estimation: scene cuts, duplicate frames, illumination changes, overlays."""
