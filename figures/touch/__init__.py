"""How does a tap become a learned decision?"""
