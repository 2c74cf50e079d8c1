"""The controllers that an experiment may name; make_controller knows them all."""
