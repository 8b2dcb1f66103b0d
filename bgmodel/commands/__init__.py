"""The commands of ``bgmodel``: one function each, whose parameters are its options."""
