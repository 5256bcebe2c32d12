"""The HADR network and the parts of which it is made."""
