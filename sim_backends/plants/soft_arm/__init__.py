"""A soft arm of chambers under fluid pressure: rod, gas, hysteresis and creep."""
