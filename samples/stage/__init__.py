"""What the rendered scenes are made of: solids and cameras, textures, and the scenes themselves."""
