"""What other libraries say to the same questions: `make oracles` installs and asks them."""
