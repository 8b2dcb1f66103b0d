"""How do other published circuits decide?"""
