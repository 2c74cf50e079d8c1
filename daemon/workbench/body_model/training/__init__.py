"""From clouds to weights; torch is imported here and nowhere else."""
