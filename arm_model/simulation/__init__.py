"""Systems of equations compiled to vector code and integrated, one arm or thousands at once."""
