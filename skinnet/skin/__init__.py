"""Where the cells are: lattices and their placement on bodies."""
