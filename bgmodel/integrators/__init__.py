"""Whatever turns evidence into OUT: the tests with their theory, baseline models, a circuit."""
