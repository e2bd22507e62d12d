"""How processes are, by their own word and as others hear them."""
