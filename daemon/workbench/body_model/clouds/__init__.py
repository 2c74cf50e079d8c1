"""What is seen of a body: configurations, point clouds, and centrelines fitted to them."""
