"""Controllers of other schools, to be compared with: each a full member of its own kind."""
