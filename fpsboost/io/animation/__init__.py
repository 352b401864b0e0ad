"""Reading and writing of GIF, APNG and animated WebP."""
