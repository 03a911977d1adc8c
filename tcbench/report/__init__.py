"""Tables to charts to a page."""
