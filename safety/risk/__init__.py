"""The risk of touching something: mixtures of where the body is, against what surrounds it."""
