"""Models whose choices and times come from trials that are simulated once, such as circuits."""
