"""Many experiments side by side: a paper's tables, and comparisons of controllers."""
