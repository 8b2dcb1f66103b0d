"""Theory of circuits: f-I curves of cells, finite-size noise, stability and homeostasis."""
