"""What renderers bring beside their images: motion vectors and depth, and the conventions in which they are stored."""
