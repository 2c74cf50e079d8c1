"""Concentric tubes: precurved elastic tubes in each other, turned and pushed at their ends."""
