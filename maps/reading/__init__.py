"""Reading: files of users, and how messages show what stands in them."""
