"""Which published numbers does each circuit reproduce?"""
