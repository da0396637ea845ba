"""The Cosserat-rod reference: statics of a tendon-driven continuum robot under dead loads."""
