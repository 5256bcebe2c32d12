"""The networks and simple methods that HADR is compared with."""
