"""The tests to run after each change: `make quick`, within a minute on two idle cores."""
