"""The forward model [p, u, Δu] → Δp: pre-training and the file that keeps it."""
