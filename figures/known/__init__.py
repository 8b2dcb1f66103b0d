"""Which model decided, if all evidence is known?"""
