"""The mixture density network of a body: clouds, training, evaluation."""
