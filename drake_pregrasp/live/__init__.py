"""A run that is watched and changed while it goes on."""
