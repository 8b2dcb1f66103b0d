"""Which models can be told apart?"""
