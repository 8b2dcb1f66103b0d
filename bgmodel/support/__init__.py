"""What all of the package uses and no science: arrays, checks, files, seeds, progress."""
