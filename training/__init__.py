"""Trains the layout network on rendered homes; not part of the installed package. Run ``python -m training.run``."""
