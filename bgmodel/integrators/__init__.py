"""Whatever turns evidence into OUT: the tests, their rivals, a basal ganglia circuit."""
