"""`kb profile`: make a profile for a new domain, and check one."""
