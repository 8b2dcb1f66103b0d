"""Does it account for monkeys, people and patients?"""
