"""From an output trace to decisions: thresholds, crossings, behaviour, reward."""
