"""What belongs to several axes at once: coordinates that are made of them."""
