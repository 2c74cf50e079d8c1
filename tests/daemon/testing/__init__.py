"""The pytest plug-in, as whoever tests a robot meets it."""
