"""What the spiking circuit was tuned on, with seeds that never score."""
