"""Does dopamine trade accuracy for speed, and does it act as medication does?"""
