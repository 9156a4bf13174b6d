"""Many flights: do they agree, and if not, since when, or with what?"""
