/* Counts the stretches of straight code that the component runs through: the compiler calls this at the start of each. */
long stretches;

void __sanitizer_cov_trace_pc(void)
{
    stretches++;
}
