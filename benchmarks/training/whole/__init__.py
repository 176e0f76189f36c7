"""The whole: what was learned in parts, played where everything goes on."""
