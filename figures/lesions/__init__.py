"""What do lesions do, and conflict?"""
