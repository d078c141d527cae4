"""Safe regions of the contacts, and their further constraints."""
