"""Learning a threshold from reward: REINFORCE, its policies and its environments."""
