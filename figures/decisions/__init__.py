"""Does the circuit decide optimally?"""
