"""The linear regression behind every method: equations, base parameters, least squares, uncertainty."""
