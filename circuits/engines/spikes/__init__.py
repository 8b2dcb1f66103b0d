"""The spikes engine: thousands of spiking trials, compiled."""
