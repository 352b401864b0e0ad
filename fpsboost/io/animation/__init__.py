"""GIF, APNG and animated WebP: pieces drawn onto a canvas, each shown for its own time."""
