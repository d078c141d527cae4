"""The paper's ten cases, and its tables, figures and claims."""
