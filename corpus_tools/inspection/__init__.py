"""Looking at what files hold."""
