"""How a loop's rows come: at its samples' rate, or by exception, on change only. Pure; stands before detection."""
