"""Where model and measurement disagree: the missing effect, named, added, and the gap after it."""
