"""How far a model of a body can be trusted: likelihood, and contacts that came about."""
