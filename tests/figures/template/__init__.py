"""What is six times seven?"""
