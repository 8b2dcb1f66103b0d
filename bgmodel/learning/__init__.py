"""Learning a threshold from reward: REINFORCE, its policy and its environments."""
