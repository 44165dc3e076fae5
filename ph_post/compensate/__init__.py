"""Compensation: the nominal plan, the profiles of section 5, and the strategies that place them."""
