"""What a sequential test must do: closed forms, first passages, exact recursions."""
