"""From native data layouts to the canonical benchmark folder (``airzoo-bench prepare``)."""
