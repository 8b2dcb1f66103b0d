"""Stop signals as a model of trials, which the common engine fits."""
