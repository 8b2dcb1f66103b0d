"""The ensemble engine: thousands of spiking trials, compiled."""
