// Reads dashboards with the types of Grafana's own SDK, strictly: an unknown or missing key, or a value that Grafana's
// schema does not allow, is an error. Panels and queries are read as those of their plugins.
package main

import (
	"errors"
	"fmt"
	"os"

	"github.com/grafana/grafana-foundation-sdk/go/cog"
	"github.com/grafana/grafana-foundation-sdk/go/cog/plugins"
	"github.com/grafana/grafana-foundation-sdk/go/dashboard"
)

func main() {
	plugins.RegisterDefaultPlugins()
	status := 0
	for _, name := range os.Args[1:] {
		if err := check(name); err != nil {
			fmt.Printf("%s: %v\n", name, err)
			status = 1
		}
	}
	os.Exit(status)
}

func check(name string) error {
	text, err := os.ReadFile(name)
	if err != nil {
		return err
	}
	found := dashboard.Dashboard{}
	if err := known(found.UnmarshalJSONStrict(text)); err != nil {
		return err
	}
	if err := known(found.Validate()); err != nil {
		return err
	}
	fmt.Printf("%s: %d panels, valid\n", name, len(found.Panels))
	return nil
}

// The SDK returns an empty list of errors as an error.
func known(err error) error {
	var list cog.BuildErrors
	if errors.As(err, &list) && len(list) == 0 {
		return nil
	}
	return err
}
