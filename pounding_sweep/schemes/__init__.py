"""How time is stepped: the text of one step of each scheme, and its stability."""
