"""The words of `tentacled mdn`."""
