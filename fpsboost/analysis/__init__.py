"""What frames tell before motion is estimated: scene cuts, duplicates, illumination, overlays."""
