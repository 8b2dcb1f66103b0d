"""What can reward teach: caution, the meaning of evidence, values?"""
