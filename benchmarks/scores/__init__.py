"""What the model does on seeds that tuned nothing."""
