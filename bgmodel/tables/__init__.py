"""Tables that people bring and take: trials, evidence, exports."""
