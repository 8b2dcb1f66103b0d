"""Does it agree with other tools?"""
