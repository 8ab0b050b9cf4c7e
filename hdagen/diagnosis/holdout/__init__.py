"""What of a verdict holds on motion that no fit saw: withdrawn, doubted, replaced, or left to the unknown."""
