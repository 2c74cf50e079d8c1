"""What belongs to several axes at once: coordinates made of them, and limits on their sums."""
