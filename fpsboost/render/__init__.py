"""What renderers bring beside their images: motion vectors and depth."""
