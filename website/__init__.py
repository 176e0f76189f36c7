"""Website: what the pages of the site take in when it is built."""
