"""From frames to samples (p, u, Δu, Δp): sampler, tables, data sets, receptive fields."""
