"""What a robot is to do: experiments, explorations, trajectories, controllers and studies."""
