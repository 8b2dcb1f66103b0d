"""Speed, tuning, and the scripts that built the shipped data and network."""
