"""Page of a comparison: `page` puts it together, `charts` draws figures, `pictures` crops and encodes frames."""
