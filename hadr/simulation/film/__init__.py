"""Films of attempts."""
