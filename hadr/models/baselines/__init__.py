"""Methods that HADR is compared with."""
