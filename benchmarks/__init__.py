"""Speed and tuning, and what built the shipped data and network."""
