"""The commands of ``bgmodel``: a dataclass each, its fields the options, its call the work."""
