"""Whatever turns evidence into OUT: the tests, baseline models, a basal ganglia circuit."""
