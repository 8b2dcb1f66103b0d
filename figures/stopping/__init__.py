"""Can it stop, and do people stop as a race does?"""
