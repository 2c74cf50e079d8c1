"""How likely a body touches something, at run time: mixture, environment, body_point, contact."""
