"""A comparison as one page: figures, tables, a player, and pictures to look at closely."""
