"""What the constructed clips are made of: a raster, textures, and the clips themselves, kind by kind."""
