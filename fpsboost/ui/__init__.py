"""A page on this machine on which a clip is chosen, looked at and converted, for people who use no terminal."""
